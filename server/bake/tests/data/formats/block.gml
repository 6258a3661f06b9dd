<?xml version="1.0" encoding="UTF-8"?>
<CityModel xmlns="http://www.opengis.net/citygml/2.0" xmlns:gml="http://www.opengis.net/gml"
 xmlns:bldg="http://www.opengis.net/citygml/building/2.0">
<gml:boundedBy><gml:Envelope srsName="urn:ogc:def:crs:EPSG::25832" srsDimension="3"><gml:lowerCorner>500000 5400000 0</gml:lowerCorner><gml:upperCorner>500122 5400050 64</gml:upperCorner></gml:Envelope></gml:boundedBy>
<cityObjectMember><bldg:Building gml:id="court"><bldg:usage>residential</bldg:usage><bldg:measuredHeight uom="m">18.5</bldg:measuredHeight><bldg:storeysAboveGround>5</bldg:storeysAboveGround>
<bldg:boundedBy><bldg:RoofSurface><bldg:lod2MultiSurface><gml:MultiSurface><gml:surfaceMember><gml:Polygon>
<gml:exterior><gml:LinearRing><gml:posList>500000.000 5400000.000 18.500 500040.000 5400000.000 18.500 500040.000 5400030.000 18.500 500000.000 5400030.000 18.500 500000.000 5400000.000 18.500</gml:posList></gml:LinearRing></gml:exterior>
<gml:interior><gml:LinearRing><gml:posList>500010.000 5400020.000 18.500 500030.000 5400020.000 18.500 500030.000 5400010.000 18.500 500010.000 5400010.000 18.500 500010.000 5400020.000 18.500</gml:posList></gml:LinearRing></gml:interior>
</gml:Polygon></gml:surfaceMember></gml:MultiSurface></bldg:lod2MultiSurface></bldg:RoofSurface></bldg:boundedBy>
<bldg:boundedBy><bldg:GroundSurface><bldg:lod2MultiSurface><gml:MultiSurface><gml:surfaceMember><gml:Polygon>
<gml:exterior><gml:LinearRing><gml:posList>500000.000 5400030.000 0.000 500040.000 5400030.000 0.000 500040.000 5400000.000 0.000 500000.000 5400000.000 0.000 500000.000 5400030.000 0.000</gml:posList></gml:LinearRing></gml:exterior>
<gml:interior><gml:LinearRing><gml:posList>500010.000 5400010.000 0.000 500030.000 5400010.000 0.000 500030.000 5400020.000 0.000 500010.000 5400020.000 0.000 500010.000 5400010.000 0.000</gml:posList></gml:LinearRing></gml:interior>
</gml:Polygon></gml:surfaceMember></gml:MultiSurface></bldg:lod2MultiSurface></bldg:GroundSurface></bldg:boundedBy>
<bldg:boundedBy><bldg:WallSurface><bldg:lod2MultiSurface><gml:MultiSurface><gml:surfaceMember><gml:Polygon>
<gml:exterior><gml:LinearRing><gml:posList>500000.000 5400000.000 0.000 500040.000 5400000.000 0.000 500040.000 5400000.000 18.500 500000.000 5400000.000 18.500 500000.000 5400000.000 0.000</gml:posList></gml:LinearRing></gml:exterior>
</gml:Polygon></gml:surfaceMember></gml:MultiSurface></bldg:lod2MultiSurface></bldg:WallSurface></bldg:boundedBy>
<bldg:boundedBy><bldg:WallSurface><bldg:lod2MultiSurface><gml:MultiSurface><gml:surfaceMember><gml:Polygon>
<gml:exterior><gml:LinearRing><gml:posList>500040.000 5400000.000 0.000 500040.000 5400030.000 0.000 500040.000 5400030.000 18.500 500040.000 5400000.000 18.500 500040.000 5400000.000 0.000</gml:posList></gml:LinearRing></gml:exterior>
</gml:Polygon></gml:surfaceMember></gml:MultiSurface></bldg:lod2MultiSurface></bldg:WallSurface></bldg:boundedBy>
<bldg:boundedBy><bldg:WallSurface><bldg:lod2MultiSurface><gml:MultiSurface><gml:surfaceMember><gml:Polygon>
<gml:exterior><gml:LinearRing><gml:posList>500040.000 5400030.000 0.000 500000.000 5400030.000 0.000 500000.000 5400030.000 18.500 500040.000 5400030.000 18.500 500040.000 5400030.000 0.000</gml:posList></gml:LinearRing></gml:exterior>
</gml:Polygon></gml:surfaceMember></gml:MultiSurface></bldg:lod2MultiSurface></bldg:WallSurface></bldg:boundedBy>
<bldg:boundedBy><bldg:WallSurface><bldg:lod2MultiSurface><gml:MultiSurface><gml:surfaceMember><gml:Polygon>
<gml:exterior><gml:LinearRing><gml:posList>500000.000 5400030.000 0.000 500000.000 5400000.000 0.000 500000.000 5400000.000 18.500 500000.000 5400030.000 18.500 500000.000 5400030.000 0.000</gml:posList></gml:LinearRing></gml:exterior>
</gml:Polygon></gml:surfaceMember></gml:MultiSurface></bldg:lod2MultiSurface></bldg:WallSurface></bldg:boundedBy>
<bldg:boundedBy><bldg:WallSurface><bldg:lod2MultiSurface><gml:MultiSurface><gml:surfaceMember><gml:Polygon>
<gml:exterior><gml:LinearRing><gml:posList>500010.000 5400020.000 0.000 500030.000 5400020.000 0.000 500030.000 5400020.000 18.500 500010.000 5400020.000 18.500 500010.000 5400020.000 0.000</gml:posList></gml:LinearRing></gml:exterior>
</gml:Polygon></gml:surfaceMember></gml:MultiSurface></bldg:lod2MultiSurface></bldg:WallSurface></bldg:boundedBy>
<bldg:boundedBy><bldg:WallSurface><bldg:lod2MultiSurface><gml:MultiSurface><gml:surfaceMember><gml:Polygon>
<gml:exterior><gml:LinearRing><gml:posList>500030.000 5400020.000 0.000 500030.000 5400010.000 0.000 500030.000 5400010.000 18.500 500030.000 5400020.000 18.500 500030.000 5400020.000 0.000</gml:posList></gml:LinearRing></gml:exterior>
</gml:Polygon></gml:surfaceMember></gml:MultiSurface></bldg:lod2MultiSurface></bldg:WallSurface></bldg:boundedBy>
<bldg:boundedBy><bldg:WallSurface><bldg:lod2MultiSurface><gml:MultiSurface><gml:surfaceMember><gml:Polygon>
<gml:exterior><gml:LinearRing><gml:posList>500030.000 5400010.000 0.000 500010.000 5400010.000 0.000 500010.000 5400010.000 18.500 500030.000 5400010.000 18.500 500030.000 5400010.000 0.000</gml:posList></gml:LinearRing></gml:exterior>
</gml:Polygon></gml:surfaceMember></gml:MultiSurface></bldg:lod2MultiSurface></bldg:WallSurface></bldg:boundedBy>
<bldg:boundedBy><bldg:WallSurface><bldg:lod2MultiSurface><gml:MultiSurface><gml:surfaceMember><gml:Polygon>
<gml:exterior><gml:LinearRing><gml:posList>500010.000 5400010.000 0.000 500010.000 5400020.000 0.000 500010.000 5400020.000 18.500 500010.000 5400010.000 18.500 500010.000 5400010.000 0.000</gml:posList></gml:LinearRing></gml:exterior>
</gml:Polygon></gml:surfaceMember></gml:MultiSurface></bldg:lod2MultiSurface></bldg:WallSurface></bldg:boundedBy>
</bldg:Building></cityObjectMember>
<cityObjectMember><bldg:Building gml:id="halls"><bldg:usage>industrial</bldg:usage><bldg:measuredHeight uom="m">9.25</bldg:measuredHeight><bldg:storeysAboveGround>2</bldg:storeysAboveGround>
<bldg:boundedBy><bldg:RoofSurface><bldg:lod2MultiSurface><gml:MultiSurface><gml:surfaceMember><gml:Polygon>
<gml:exterior><gml:LinearRing><gml:posList>500060.000 5400000.000 9.250 500090.000 5400000.000 9.250 500090.000 5400020.000 9.250 500060.000 5400020.000 9.250 500060.000 5400000.000 9.250</gml:posList></gml:LinearRing></gml:exterior>
</gml:Polygon></gml:surfaceMember></gml:MultiSurface></bldg:lod2MultiSurface></bldg:RoofSurface></bldg:boundedBy>
<bldg:boundedBy><bldg:GroundSurface><bldg:lod2MultiSurface><gml:MultiSurface><gml:surfaceMember><gml:Polygon>
<gml:exterior><gml:LinearRing><gml:posList>500060.000 5400020.000 0.000 500090.000 5400020.000 0.000 500090.000 5400000.000 0.000 500060.000 5400000.000 0.000 500060.000 5400020.000 0.000</gml:posList></gml:LinearRing></gml:exterior>
</gml:Polygon></gml:surfaceMember></gml:MultiSurface></bldg:lod2MultiSurface></bldg:GroundSurface></bldg:boundedBy>
<bldg:boundedBy><bldg:WallSurface><bldg:lod2MultiSurface><gml:MultiSurface><gml:surfaceMember><gml:Polygon>
<gml:exterior><gml:LinearRing><gml:posList>500060.000 5400000.000 0.000 500090.000 5400000.000 0.000 500090.000 5400000.000 9.250 500060.000 5400000.000 9.250 500060.000 5400000.000 0.000</gml:posList></gml:LinearRing></gml:exterior>
</gml:Polygon></gml:surfaceMember></gml:MultiSurface></bldg:lod2MultiSurface></bldg:WallSurface></bldg:boundedBy>
<bldg:boundedBy><bldg:WallSurface><bldg:lod2MultiSurface><gml:MultiSurface><gml:surfaceMember><gml:Polygon>
<gml:exterior><gml:LinearRing><gml:posList>500090.000 5400000.000 0.000 500090.000 5400020.000 0.000 500090.000 5400020.000 9.250 500090.000 5400000.000 9.250 500090.000 5400000.000 0.000</gml:posList></gml:LinearRing></gml:exterior>
</gml:Polygon></gml:surfaceMember></gml:MultiSurface></bldg:lod2MultiSurface></bldg:WallSurface></bldg:boundedBy>
<bldg:boundedBy><bldg:WallSurface><bldg:lod2MultiSurface><gml:MultiSurface><gml:surfaceMember><gml:Polygon>
<gml:exterior><gml:LinearRing><gml:posList>500090.000 5400020.000 0.000 500060.000 5400020.000 0.000 500060.000 5400020.000 9.250 500090.000 5400020.000 9.250 500090.000 5400020.000 0.000</gml:posList></gml:LinearRing></gml:exterior>
</gml:Polygon></gml:surfaceMember></gml:MultiSurface></bldg:lod2MultiSurface></bldg:WallSurface></bldg:boundedBy>
<bldg:boundedBy><bldg:WallSurface><bldg:lod2MultiSurface><gml:MultiSurface><gml:surfaceMember><gml:Polygon>
<gml:exterior><gml:LinearRing><gml:posList>500060.000 5400020.000 0.000 500060.000 5400000.000 0.000 500060.000 5400000.000 9.250 500060.000 5400020.000 9.250 500060.000 5400020.000 0.000</gml:posList></gml:LinearRing></gml:exterior>
</gml:Polygon></gml:surfaceMember></gml:MultiSurface></bldg:lod2MultiSurface></bldg:WallSurface></bldg:boundedBy>
<bldg:boundedBy><bldg:RoofSurface><bldg:lod2MultiSurface><gml:MultiSurface><gml:surfaceMember><gml:Polygon>
<gml:exterior><gml:LinearRing><gml:posList>500060.000 5400030.000 9.250 500090.000 5400030.000 9.250 500090.000 5400050.000 9.250 500060.000 5400050.000 9.250 500060.000 5400030.000 9.250</gml:posList></gml:LinearRing></gml:exterior>
</gml:Polygon></gml:surfaceMember></gml:MultiSurface></bldg:lod2MultiSurface></bldg:RoofSurface></bldg:boundedBy>
<bldg:boundedBy><bldg:GroundSurface><bldg:lod2MultiSurface><gml:MultiSurface><gml:surfaceMember><gml:Polygon>
<gml:exterior><gml:LinearRing><gml:posList>500060.000 5400050.000 0.000 500090.000 5400050.000 0.000 500090.000 5400030.000 0.000 500060.000 5400030.000 0.000 500060.000 5400050.000 0.000</gml:posList></gml:LinearRing></gml:exterior>
</gml:Polygon></gml:surfaceMember></gml:MultiSurface></bldg:lod2MultiSurface></bldg:GroundSurface></bldg:boundedBy>
<bldg:boundedBy><bldg:WallSurface><bldg:lod2MultiSurface><gml:MultiSurface><gml:surfaceMember><gml:Polygon>
<gml:exterior><gml:LinearRing><gml:posList>500060.000 5400030.000 0.000 500090.000 5400030.000 0.000 500090.000 5400030.000 9.250 500060.000 5400030.000 9.250 500060.000 5400030.000 0.000</gml:posList></gml:LinearRing></gml:exterior>
</gml:Polygon></gml:surfaceMember></gml:MultiSurface></bldg:lod2MultiSurface></bldg:WallSurface></bldg:boundedBy>
<bldg:boundedBy><bldg:WallSurface><bldg:lod2MultiSurface><gml:MultiSurface><gml:surfaceMember><gml:Polygon>
<gml:exterior><gml:LinearRing><gml:posList>500090.000 5400030.000 0.000 500090.000 5400050.000 0.000 500090.000 5400050.000 9.250 500090.000 5400030.000 9.250 500090.000 5400030.000 0.000</gml:posList></gml:LinearRing></gml:exterior>
</gml:Polygon></gml:surfaceMember></gml:MultiSurface></bldg:lod2MultiSurface></bldg:WallSurface></bldg:boundedBy>
<bldg:boundedBy><bldg:WallSurface><bldg:lod2MultiSurface><gml:MultiSurface><gml:surfaceMember><gml:Polygon>
<gml:exterior><gml:LinearRing><gml:posList>500090.000 5400050.000 0.000 500060.000 5400050.000 0.000 500060.000 5400050.000 9.250 500090.000 5400050.000 9.250 500090.000 5400050.000 0.000</gml:posList></gml:LinearRing></gml:exterior>
</gml:Polygon></gml:surfaceMember></gml:MultiSurface></bldg:lod2MultiSurface></bldg:WallSurface></bldg:boundedBy>
<bldg:boundedBy><bldg:WallSurface><bldg:lod2MultiSurface><gml:MultiSurface><gml:surfaceMember><gml:Polygon>
<gml:exterior><gml:LinearRing><gml:posList>500060.000 5400050.000 0.000 500060.000 5400030.000 0.000 500060.000 5400030.000 9.250 500060.000 5400050.000 9.250 500060.000 5400050.000 0.000</gml:posList></gml:LinearRing></gml:exterior>
</gml:Polygon></gml:surfaceMember></gml:MultiSurface></bldg:lod2MultiSurface></bldg:WallSurface></bldg:boundedBy>
</bldg:Building></cityObjectMember>
<cityObjectMember><bldg:Building gml:id="tower"><bldg:usage>office</bldg:usage><bldg:measuredHeight uom="m">64.0</bldg:measuredHeight><bldg:storeysAboveGround>20</bldg:storeysAboveGround>
<bldg:boundedBy><bldg:RoofSurface><bldg:lod2MultiSurface><gml:MultiSurface><gml:surfaceMember><gml:Polygon>
<gml:exterior><gml:LinearRing><gml:posList>500110.000 5400010.000 64.000 500122.000 5400010.000 64.000 500122.000 5400022.000 64.000 500110.000 5400022.000 64.000 500110.000 5400010.000 64.000</gml:posList></gml:LinearRing></gml:exterior>
</gml:Polygon></gml:surfaceMember></gml:MultiSurface></bldg:lod2MultiSurface></bldg:RoofSurface></bldg:boundedBy>
<bldg:boundedBy><bldg:GroundSurface><bldg:lod2MultiSurface><gml:MultiSurface><gml:surfaceMember><gml:Polygon>
<gml:exterior><gml:LinearRing><gml:posList>500110.000 5400022.000 0.000 500122.000 5400022.000 0.000 500122.000 5400010.000 0.000 500110.000 5400010.000 0.000 500110.000 5400022.000 0.000</gml:posList></gml:LinearRing></gml:exterior>
</gml:Polygon></gml:surfaceMember></gml:MultiSurface></bldg:lod2MultiSurface></bldg:GroundSurface></bldg:boundedBy>
<bldg:boundedBy><bldg:WallSurface><bldg:lod2MultiSurface><gml:MultiSurface><gml:surfaceMember><gml:Polygon>
<gml:exterior><gml:LinearRing><gml:posList>500110.000 5400010.000 0.000 500122.000 5400010.000 0.000 500122.000 5400010.000 64.000 500110.000 5400010.000 64.000 500110.000 5400010.000 0.000</gml:posList></gml:LinearRing></gml:exterior>
</gml:Polygon></gml:surfaceMember></gml:MultiSurface></bldg:lod2MultiSurface></bldg:WallSurface></bldg:boundedBy>
<bldg:boundedBy><bldg:WallSurface><bldg:lod2MultiSurface><gml:MultiSurface><gml:surfaceMember><gml:Polygon>
<gml:exterior><gml:LinearRing><gml:posList>500122.000 5400010.000 0.000 500122.000 5400022.000 0.000 500122.000 5400022.000 64.000 500122.000 5400010.000 64.000 500122.000 5400010.000 0.000</gml:posList></gml:LinearRing></gml:exterior>
</gml:Polygon></gml:surfaceMember></gml:MultiSurface></bldg:lod2MultiSurface></bldg:WallSurface></bldg:boundedBy>
<bldg:boundedBy><bldg:WallSurface><bldg:lod2MultiSurface><gml:MultiSurface><gml:surfaceMember><gml:Polygon>
<gml:exterior><gml:LinearRing><gml:posList>500122.000 5400022.000 0.000 500110.000 5400022.000 0.000 500110.000 5400022.000 64.000 500122.000 5400022.000 64.000 500122.000 5400022.000 0.000</gml:posList></gml:LinearRing></gml:exterior>
</gml:Polygon></gml:surfaceMember></gml:MultiSurface></bldg:lod2MultiSurface></bldg:WallSurface></bldg:boundedBy>
<bldg:boundedBy><bldg:WallSurface><bldg:lod2MultiSurface><gml:MultiSurface><gml:surfaceMember><gml:Polygon>
<gml:exterior><gml:LinearRing><gml:posList>500110.000 5400022.000 0.000 500110.000 5400010.000 0.000 500110.000 5400010.000 64.000 500110.000 5400022.000 64.000 500110.000 5400022.000 0.000</gml:posList></gml:LinearRing></gml:exterior>
</gml:Polygon></gml:surfaceMember></gml:MultiSurface></bldg:lod2MultiSurface></bldg:WallSurface></bldg:boundedBy>
</bldg:Building></cityObjectMember>
</CityModel>
